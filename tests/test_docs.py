"""The pages keep their word: they build without a warning and without a network, and all that is in them runs."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from pages import ROOT, block_texts, blocks_of, copy_the_clone, looks_like, run_page
from ruamel.yaml import YAML

import fopi_tune
from fopi_tune.core.distributions import DISTRIBUTIONS
from fopi_tune.core.plant import PLANT_MODELS
from fopi_tune.quantities import QUANTITIES
from fopi_tune.quantities.objectives import OBJECTIVES
from fopi_tune.spec import load_any
from fopi_tune.spec.model import MEASURES, Relation
from fopi_tune.study.load import load_study

DOCS = ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if path.name != "changelog.md")
NAMES = [path.relative_to(DOCS).with_suffix("").as_posix() for path in PAGES]
