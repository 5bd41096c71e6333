"""Rigid transforms, the viewing-ray frame, and pose-error metrics."""
