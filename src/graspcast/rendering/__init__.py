"""Images of cluttered tables with ground truth, in BOP layout: for training, tests and demos."""
