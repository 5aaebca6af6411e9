"""Files: atomic writes, VTU and VTKHDF frames, and reading them back."""
