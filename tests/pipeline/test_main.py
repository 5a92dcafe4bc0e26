import sys

import pytest

from pipeline.main import main


def test_an_interrupt_while_the_command_line_is_loaded_is_one_line(monkeypatch, capsys):
    class Interrupting:
        def find_spec(self, name, path=None, target=None):
            if name == "pipeline.cli":
                raise KeyboardInterrupt

    for name in [name for name in sys.modules if name.startswith("pipeline.cli")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Interrupting(), *sys.meta_path])
    with pytest.raises(SystemExit) as ended:
        main()
    assert (ended.value.code, capsys.readouterr().err) == (130, "error: interrupted\n")
