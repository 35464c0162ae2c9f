#ifndef CONSTANTS_GLSL
#define CONSTANTS_GLSL

// Iterations that one invocation may run, all its loops together. lavapipe leaves every loop silently at 65,535.
const uint MAX_ITERATIONS = 32000u;

#endif
