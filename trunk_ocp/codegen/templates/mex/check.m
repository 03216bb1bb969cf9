function check()
% CHECK  Compares trunk_shape with check.csv and check_unloaded.csv. Build first: help trunk_shape
%
%   Prints the largest error of each part of the outputs, relative to the part's largest value;
%   ends with an error if one is above 1e-10. The files have one case per row:
%       check.csv            x, y, then J, v, dJ if they were exported
%       check_unloaded.csv   controls, y, then J if there are derivatives

  inputs = numel(trunk_shape('inputs'));
  controls = find(strcmp(trunk_shape('inputs'), 'psi_Y'));
  good = check_loaded(inputs, controls);
  good = check_unloaded(controls) && good;
  if ~good
    error('trunk:check', 'some disagree');
  end
  fprintf('all agree\n');
end

function good = check_loaded(inputs, controls)
  rows = dlmread(fullfile(fileparts(mfilename('fullpath')), 'check.csv'), ',');
  first = trunk_shape(zeros(1, controls - 2));
  n = numel(first.Z);
  ends = cumsum([0, inputs, 19 * n, 19 * n * inputs, inputs, 19 * n * inputs]);
  kinds = find(ends == size(rows, 2)) - 2;  % 1: y; 2: and J; 4: and v, dJ
  y = {};
  J = {};
  dJ = {};
  for i = 1:size(rows, 1)
    part = @(k) rows(i, ends(k) + 1:ends(k + 1));
    x = part(1);
    loads = struct('gravity', x(controls + 1), 'tip_force', x(controls + (2:4)));
    if inputs > controls + 4
      loads.contact_force = x(controls + (5:7));
      loads.contact_couple = x(controls + (8:10));
    end
    given = {x(1:controls - 2), x(controls - 1:controls), loads};
    trunk_shape('reset');  % the cases are independent of each other
    if kinds == 4
      [shape, jac, second] = trunk_shape(given{:}, part(4));
      dJ(end + 1, :) = {numbers(second), unpacked(part(5), 19, n, inputs)};
    elseif kinds == 2
      [shape, jac] = trunk_shape(given{:});
    else
      shape = trunk_shape(given{:});
    end
    y(end + 1, :) = {numbers(shape), unpacked(part(2), 19, n, 1)};
    if kinds >= 2
      J(end + 1, :) = {numbers(jac), unpacked(part(3), 19, n, inputs)};
    end
  end
  good = ~isempty(y) && report('loaded', y);
  good = report('jacobian', J) && good;
  good = report('second', dJ) && good;
end

function good = check_unloaded(controls)
  rows = dlmread(fullfile(fileparts(mfilename('fullpath')), 'check_unloaded.csv'), ',');
  first = trunk_shape('unloaded', zeros(1, controls - 2));
  n = numel(first.Z);
  y = {};
  J = {};
  for i = 1:size(rows, 1)
    x = rows(i, 1:controls);
    given = {'unloaded', x(1:controls - 2), x(controls - 1:controls)};
    if size(rows, 2) > controls + 16 * n
      [shape, jac] = trunk_shape(given{:});
      expected = unpacked(rows(i, controls + 16 * n + 1:end), 16, n, controls);
      J(end + 1, :) = {numbers(jac), expected};
    else
      shape = trunk_shape(given{:});
    end
    y(end + 1, :) = {numbers(shape), unpacked(rows(i, controls + (1:16 * n)), 16, n, 1)};
  end
  good = ~isempty(y) && report('unloaded', y);
  good = report('unloaded_jacobian', J) && good;
end

function y = numbers(shape)
% A shape, or its derivative, as an array outputs x n x inputs, in the order of the files.
  [~, n, width] = size(shape.position);
  frames = reshape(permute(shape.directors, [2 1 3 4]), [9, n, width]);
  y = cat(1, shape.position, frames, shape.strain);
  if isfield(shape, 'moment')
    y = cat(1, y, shape.moment);
  end
end

function y = unpacked(row, outputs, n, width)
% Numbers of a file, which change fastest with the input, as an array outputs x n x inputs.
  y = permute(reshape(row, [width, outputs, n]), [2 3 1]);
end

function good = report(name, pairs)
% Print the errors of each part over all cases.
  parts = {'position', 'directors', 'strain', 'moment'};
  ends = [0, 3, 12, 16, 19];
  good = true;
  for k = 1:4
    if isempty(pairs) || ends(k + 1) > size(pairs{1, 1}, 1)
      break
    end
    error_ = 0;
    scale = 0;
    for i = 1:size(pairs, 1)
      own = pairs{i, 1}(ends(k) + 1:ends(k + 1), :, :);
      expected = pairs{i, 2}(ends(k) + 1:ends(k + 1), :, :);
      difference = abs(own(:) - expected(:));
      difference(isnan(difference)) = Inf;  % max ignores NaN
      error_ = max([error_; difference]);
      scale = max([scale; abs(expected(:))]);
    end
    if scale > 1e-9  % a part that is zero up to round-off is compared by absolute error
      error_ = error_ / scale;
    end
    fprintf('%s %s %.1e\n', name, parts{k}, error_);
    good = good && error_ <= 1e-10;
  end
end
