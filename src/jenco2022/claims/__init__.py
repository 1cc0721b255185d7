"""The thesis's claims and their tests (docs/notes/claims.md)."""
