% Compares the NLP's functions with nlp_check.csv, whose lines are: x, f, g, gradient,
% nonzeros of the Jacobian, lam_f, lam_g, nonzeros of the Hessian. Build it first: help nlp

lines = dlmread(fullfile(fileparts(mfilename('fullpath')), 'nlp_check.csv'), ',');
n = numel(nlp('lower'));
m = numel(nlp('row_lower'));
[jr, jc] = nlp('pattern', 'nlp_jac_g');
[hr, hc] = nlp('pattern', 'nlp_hess_l');
ends = cumsum([0, n, 1, m, n, numel(jr), 1, m, numel(hr)]);
names = {'objective', 'constraints', 'gradient', 'jacobian', 'hessian'};
errors = zeros(1, 5);
scales = zeros(1, 5);
for i = 1:size(lines, 1)
  part = @(k) lines(i, ends(k) + 1:ends(k + 1))';
  x = part(1);
  [f, gradient] = nlp('nlp_grad_f', x);
  [g, J] = nlp('nlp_jac_g', x);
  H = nlp('nlp_hess_l', x, [], part(6), part(7));
  ours = {f, g, gradient, full(J(sub2ind(size(J), jr, jc))), full(H(sub2ind(size(H), hr, hc)))};
  expected = {part(2), part(3), part(4), part(5), part(8)};
  for k = 1:5
    difference = abs(ours{k} - expected{k});
    difference(isnan(difference)) = Inf;  % max ignores NaN
    errors(k) = max([errors(k); difference]);
    scales(k) = max([scales(k); abs(expected{k})]);
  end
end
scales(scales == 0) = 1;
shares = errors ./ scales;
for k = 1:5
  fprintf('nlp %s %.1e\n', names{k}, shares(k));
end
if any(shares > 1e-10) || isempty(lines)
  error('trunk:check', 'the NLP disagrees with nlp_check.csv');
end
