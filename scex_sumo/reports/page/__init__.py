"""Report pages: one self-contained HTML file with what a person looks at, our own JavaScript in ``assets``.

May import results and all below, and reports' tables; no matplotlib, nothing from studies or commands.
"""
