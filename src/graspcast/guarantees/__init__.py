"""Certified success rates: Learn-then-Test, certificates, drift monitoring."""
