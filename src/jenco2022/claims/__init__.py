"""The thesis's claims, and the functions that test them (docs/notes/claims.md)."""
