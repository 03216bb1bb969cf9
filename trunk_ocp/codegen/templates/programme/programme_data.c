/* The motion @NAME@ as a nonlinear programme, exported by trunk_ocp @VERSION@: bounds and start.
 * See programme.h.
 */
#include <math.h>

#include "programme.h"

