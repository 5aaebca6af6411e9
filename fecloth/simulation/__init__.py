"""Many steps: the loop over time, the choice of steps and methods, probes, the energy ledger."""
