"""Certified success rates (Learn-then-Test), certificate files, and drift monitoring."""
