% Evaluates the programme at its start: sizes, nonzeros, objective. Build it first: help programme

x = programme('start');
[f, gradient] = programme('nlp_grad_f', x);
[g, J] = programme('nlp_jac_g', x);
H = programme('nlp_hess_l', x, [], 1, zeros(size(g)));
fprintf('%d unknowns, %d constraints\n', numel(x), numel(g));
fprintf('objective %.12g\n', f);
fprintf('Jacobian: %d nonzeros; Hessian of the objective: %d nonzeros\n', nnz(J), nnz(H));
violated = max([programme('row_lower') - g; g - programme('row_upper')]);
fprintf('largest violation of a constraint %.2g\n', violated);
