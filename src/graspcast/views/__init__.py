"""Several views of a static scene: camera motion, choice and association of views, fused poses."""
