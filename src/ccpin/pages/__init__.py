"""Written pages: one self-contained HTML file with tables, figures and animations, read offline."""
