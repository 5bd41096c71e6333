"""The service: verdicts over HTTP (extra ``serve``)."""
