"""Fields in few bytes: files of encoded fields, .ssk."""
