"""Synthetic RGB images of cluttered tables, with ground truth, as a BOP dataset."""
