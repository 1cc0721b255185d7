"""Checks of codecs on small clouds: each calls a codec and says what is wrong and what to do.

A check is a function in a module of this package, registered in `puckbench.checks.registry`.
`puckbench.checks.supervision` runs all of them on a codec, in a process of their own.
"""
