"""Values as a user writes them: units, formulas, functions of time."""
