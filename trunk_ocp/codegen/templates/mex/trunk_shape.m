function varargout = trunk_shape(varargin)
% TRUNK_SHAPE  Shape of a muscular trunk, and its exact derivatives.
%
%   shape = trunk_shape(activation, head, loads)         equilibrium under loads
%   [shape, jac] = trunk_shape(activation, head, loads)  with its derivatives
%   [shape, jac, second] = trunk_shape(activation, head, loads, direction)
%   [shape, jac] = trunk_shape('unloaded', activation, head)
%   names = trunk_shape('inputs')
%   trunk_shape('reset')
%
%   activation  one number for each muscle; negative values contract
%   head        [psi_Z, psi_Y] in rad; default 0, also for []
%   loads       a struct with any of the fields
%                   gravity         in m/s^2, along +Z, which points down
%                   tip_force       (3) in N
%                   contact_force   (3) in N; both only if the trunk has a contact region
%                   contact_couple  (3) in N m
%               defaults are the values of the export: weight only
%   shape       a struct with, for n points Z of the trunk,
%                   position        3 x n, in m
%                   directors       3 x 3 x n: row i is d_i in space axes; d_3 along the trunk
%                   strain          4 x n: extension, and curvature u_1, u_2, u_3 in 1/m
%                   moment          3 x n: internal moment in N m, in the directors; loaded only
%                   Z               1 x n: points, in m along the trunk at rest
%   jac         the same fields except Z, with a last dimension for the inputs in the order of
%               `names`: position is 3 x n x inputs. Unloaded shapes depend only on
%               activations and head.
%   direction   a change of all inputs, in that order; `second` is the derivative of jac along
%               it. Only if the trunk was exported with --second.
%
%   A call starts from the shape of the last one. trunk_shape('reset') forgets it, which can matter
%   under loads of several times the trunk's weight, where there may be several equilibria.
%
%   Errors: trunk:input (wrong length, not finite), trunk:shape (no equilibrium was found),
%   trunk:usage.
%
%   To build, in MATLAB:             mex trunk_shape.c trunk.c
%   or for Octave, in a shell:       mkoctfile --mex trunk_shape.c trunk.c
%
@HEADER@
error('trunk:build', 'trunk_shape is not built yet; see: help trunk_shape');
