"""Diagnosis: what is wrong with files, found before anything is run."""
