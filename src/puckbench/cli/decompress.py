from puck.commands import add_decompress_arguments as arguments
from puck.commands import run_decompress as run

__all__ = ["arguments", "run"]
