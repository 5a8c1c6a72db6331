"""The site of the docs: every page is in its navigation, and no link or anchor leads nowhere."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest
import yaml

pytest.importorskip("zensical")

DOCS = Path(__file__).parents[1] / "docs"


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The maker of the site, with its pages gathered in a temporary folder, and no reports run."""
    spec = importlib.util.spec_from_file_location("make_site", DOCS / "make_site.py")
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    monkeypatch.setattr(made, "SITE", tmp_path)
    monkeypatch.setattr(made, "SOURCE", tmp_path / "source")
    made.gather()
    (tmp_path / "source" / "gallery.md").write_text(made.GALLERY)
    return made


def test_the_site_builds_and_every_page_is_in_its_navigation(site: ModuleType, tmp_path: Path) -> None:
    assert site.build() == 0
    assert (tmp_path / "html" / "index.html").is_file()
    groups = yaml.safe_load((DOCS / "mkdocs.yml").read_text())["nav"]
    listed = [page for group in groups for pages in group.values() for page in pages]
    assert sorted(listed) == sorted(page.name for page in (tmp_path / "source").glob("*.md"))


@pytest.mark.parametrize("link", ["nowhere.md", "metrics.md#nothing"])
def test_a_link_that_leads_nowhere_ends_the_build(site: ModuleType, tmp_path: Path, link: str) -> None:
    with (tmp_path / "source" / "data.md").open("a") as page:
        page.write(f"[lost]({link})\n")
    assert site.build() != 0
