% Position of the tip, and its derivative for each muscle. Build first: help trunk_shape

names = trunk_shape('inputs');
muscles = find(strcmp(names, 'psi_Z')) - 1;
[shape, jac] = trunk_shape(zeros(1, muscles));
fprintf('Z = %g m is at (%.4f, %.4f, %.4f) m\n', shape.Z(end), shape.position(:, end));
for i = 1:muscles
  fprintf('%-12s moves it by (%7.3f, %7.3f, %7.3f) m for an activation of 1\n', ...
          names{i}, jac.position(:, end, i));
end
tic;
for i = 1:200
  [shape, jac] = trunk_shape(-0.001 * i * ones(1, muscles));
end
fprintf('a shape with its derivatives: %.3f ms\n', 1e3 * toc / 200);
