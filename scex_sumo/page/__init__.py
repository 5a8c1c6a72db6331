"""Report pages: self-contained HTML files with the JavaScript of ``assets``; no matplotlib in them."""
