"""The border to files of others: the BOP benchmark's formats and the paper authors' release.

Millimetres become metres here and nowhere else.
"""
