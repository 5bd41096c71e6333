"""The BOP benchmark's file formats: datasets, models, images, results and detections.

Millimetres are converted to metres here and nowhere else.
"""
