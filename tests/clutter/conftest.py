"""What tests of both backgrounds, of a whole run and of the scans so far, look at."""

import pytest
from drive_images import drive_images


@pytest.fixture
def scans():
    return drive_images()
