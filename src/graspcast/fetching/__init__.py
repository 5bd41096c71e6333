"""Downloads of public data into the cache: resumed, checked, and unpacked with care."""
