"""Pages, tables, figures and videos that show a recording."""
