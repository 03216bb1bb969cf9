function varargout = nlp(varargin)
% NLP  The motion @NAME@ as an NLP, exported by trunk_ocp @VERSION@.
%
%   minimize f(x)  subject to  lower <= x <= upper  and  row_lower <= g(x) <= row_upper
%
%   f = nlp('nlp_f', x)
%   g = nlp('nlp_g', x)
%   [f, g] = nlp('nlp', x)
%   [f, gradient] = nlp('nlp_grad_f', x)
%   [g, J] = nlp('nlp_jac_g', x)                      sparse Jacobian of g
%   H = nlp('nlp_hess_l', x, [], lam_f, lam_g)        sparse upper triangle of the Hessian of
%                                                     lam_f * f + lam_g' * g
%   lower = nlp('lower'), likewise 'upper', 'row_lower', 'row_upper'
%   x = nlp('start')                                  the passive trunk
%   [rows, columns] = nlp('pattern', 'nlp_jac_g')     where J, or H, may have nonzeros
%
%   @STEPS@ time steps: @UNKNOWNS@ unknowns x, @ROWS@ constraints g. Lengths are in units of
%   @LENGTH@ m, forces of @FORCE@ N and moments of @MOMENT@ N m; angles are in rad, f is in m^2.
%   layout.json names every unknown, row and parameter. The second input of the functions, after
%   x, is a change of the motion's @PARAMETERS@ parameters (parameters.csv), for example to move a
%   target; [] or nothing leaves the motion unchanged.
%
%   To build, in MATLAB:
%       mex -output nlp nlp_mex.c nlp.c nlp_data.c
%   or in a shell, for Octave:
%       mkoctfile --mex -o nlp.mex nlp_mex.c nlp.c nlp_data.c

error('trunk:build', 'nlp is not built yet; see: help nlp');
