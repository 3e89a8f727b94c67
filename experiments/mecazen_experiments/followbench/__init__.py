"""Episodes, metrics and planners of Follow-Bench 1.0 (arXiv 2509.10796)."""
