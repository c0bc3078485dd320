"""Studies: each plans its calls with run() and reads its ledger with score()."""
