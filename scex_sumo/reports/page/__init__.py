"""Report pages: self-contained HTML files; their JavaScript is in ``assets``.

May import results, views and reports' tables and all below; no matplotlib.
"""
