"""Sources of native functions: a section of a file, with its head, inclusions and values."""

from deformrf.core.base.native import native_source


def test_a_section_has_the_files_head_and_no_other_section(tmp_path):
    (tmp_path / "shared.h").write_text("int shared = @COUNT;\n")
    source = tmp_path / "bodies.cu"
    head = '#include "shared.h"\nint head;\n'
    source.write_text(head + "//# one\nreturn 1;\n//# two\nreturn @COUNT;\n")
    found = native_source(source, [tmp_path / "shared.h"], {"COUNT": 3}, section="two")
    assert found == "int shared = 3;\nint head;\nreturn 3;\n"
