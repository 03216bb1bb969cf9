/* The motion @NAME@ as an NLP, exported by trunk_ocp @VERSION@: its functions.
 * nlp.h says what they are, in which units, and how to call them.
 */

/* All functions that CasADi generates have the same five arguments, whether they need them or not. */
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

