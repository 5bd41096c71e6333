"""The report: what was judged, by what, and how well, as one HTML file."""
