"""The catalogue of trust: which runs are wrong, and which warn."""
