"""The command line, run in this process."""

from __future__ import annotations

from click.testing import CliRunner, Result

from sheetsplat.cli import main


def run(*arguments: object, code: int = 0) -> Result:
    """Run a command and check its exit code."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exit_code == code, (result.exit_code, result.output, result.exception)
    return result
