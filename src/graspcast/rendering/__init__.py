"""Rendering: overlays on images, simulated trials, and synthetic BOP datasets."""
