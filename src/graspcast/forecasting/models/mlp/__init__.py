"""The paper's small multilayer perceptrons, many trained at once by compiled SIMD code."""
