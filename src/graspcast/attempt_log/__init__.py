"""The attempt log: every decision and its outcome, in one append-only file."""
