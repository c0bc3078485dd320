"""Pages, figures, tables and contact sheets."""
