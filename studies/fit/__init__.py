"""What `fc.fit` finds in data whose constants are known, and in measured data."""
