"""Reports: figures and terminal tables; the only package with matplotlib."""
