"""Two knits, drawn along courses and along wales."""
