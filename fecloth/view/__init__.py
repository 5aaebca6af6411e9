"""Pictures, pages and charts of a run."""
