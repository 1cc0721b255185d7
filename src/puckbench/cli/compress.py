from puck.commands import add_compress_arguments as arguments
from puck.commands import run_compress as run

__all__ = ["arguments", "run"]
