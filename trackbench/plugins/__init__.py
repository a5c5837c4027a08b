"""Code of plugins: loaded, checked, and run so that its errors become located lines."""
