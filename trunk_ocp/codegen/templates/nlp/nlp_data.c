/* The motion @NAME@ as an NLP, exported by trunk_ocp @VERSION@: bounds and start.
 * See nlp.h.
 */
#include <math.h>

#include "nlp.h"

