"""The paper's small multilayer perceptrons, trained in parallel by compiled SIMD code."""
