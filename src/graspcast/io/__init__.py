"""Files: atomic writes, locks, JSON, TOML, tables, Markdown, digests, conformance reports."""
