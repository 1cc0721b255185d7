"""The thesis's claims, tested one by one on what a run has measured: see docs/notes/claims.md."""
