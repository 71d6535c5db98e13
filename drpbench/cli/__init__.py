"""The command line: thin, one function a command. Everything heavy is imported inside."""

from .app import main as main
