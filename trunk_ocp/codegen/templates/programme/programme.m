function varargout = programme(varargin)
% PROGRAMME  The motion @NAME@ as a nonlinear programme, exported by trunk_ocp @VERSION@.
%
%   minimise f(x)  subject to  lower <= x <= upper  and  row_lower <= g(x) <= row_upper
%
%   f = programme('nlp_f', x)
%   g = programme('nlp_g', x)
%   [f, g] = programme('nlp', x)
%   [f, gradient] = programme('nlp_grad_f', x)
%   [g, J] = programme('nlp_jac_g', x)                      sparse Jacobian of g
%   H = programme('nlp_hess_l', x, [], lam_f, lam_g)        sparse upper triangle of the Hessian
%                                                           of lam_f * f + lam_g' * g
%   lower = programme('lower'), and so 'upper', 'row_lower', 'row_upper'
%   x = programme('start')                                  the passive trunk
%   [rows, columns] = programme('pattern', 'nlp_jac_g')     where J, or H, may have nonzeros
%
%   @STEPS@ time steps: @UNKNOWNS@ unknowns x, @ROWS@ constraints g. Lengths are in units of
%   @LENGTH@ m, forces of @FORCE@ N and moments of @MOMENT@ N m; angles are in rad, f is in m^2.
%   layout.json says what each unknown, row and parameter is. The second input of the functions,
%   after x, is a change of the motion's own @PARAMETERS@ parameters (parameters.csv), such as a
%   target that moves; left out or [], it is 0.
%
%   To build, in MATLAB:
%       mex -output programme programme_mex.c programme.c programme_data.c
%   or in a shell, for Octave:
%       mkoctfile --mex -o programme.mex programme_mex.c programme.c programme_data.c

error('trunk:build', 'programme is not built yet; see: help programme');
