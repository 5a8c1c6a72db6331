"""Report pages: self-contained HTML files with the JavaScript of ``assets``; no matplotlib in them.

``report`` is the page of a run, ``figures`` are charts and figures, ``study`` is the page of a study, and
``timeline`` shows a recording.
"""
