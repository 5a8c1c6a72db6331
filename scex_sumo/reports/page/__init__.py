"""Report pages: each is one self-contained HTML file; its JavaScript is in ``assets``.

May import results and all below, and reports' tables; no matplotlib, nothing from studies or commands.
"""
