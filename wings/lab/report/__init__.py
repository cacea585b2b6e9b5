"""The report as files: page, Markdown, JSON, tables and plots."""
