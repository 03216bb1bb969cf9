% Evaluates the NLP at its start: sizes, nonzeros, objective. Build it first: help nlp

x = nlp('start');
[f, gradient] = nlp('nlp_grad_f', x);
[g, J] = nlp('nlp_jac_g', x);
H = nlp('nlp_hess_l', x, [], 1, zeros(size(g)));
fprintf('%d unknowns, %d constraints\n', numel(x), numel(g));
fprintf('objective %.12g\n', f);
fprintf('Jacobian: %d nonzeros; Hessian of the objective: %d nonzeros\n', nnz(J), nnz(H));
violated = max([nlp('row_lower') - g; g - nlp('row_upper')]);
fprintf('largest violation of a constraint %.2g\n', violated);
