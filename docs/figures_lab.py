"""The picture of docs/lab.md: `python docs/figures_lab.py`, with Chromium on the machine.

The page of `exosight lab`, driven up to 4 N and back to 2.6 N.
"""

import os
import shutil
import threading
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from exosight.lab.security import LOOPBACK
from exosight.lab.server import application, listen, server_of
from exosight.lab.settings import View
from exosight.lab.system import open_system

VIEW = View(drive=((4.0,), (2.6,)))
TARGET = Path(__file__).parent / "images" / "lab.png"


def main() -> None:
    """Serve the page, open it, and keep what is seen."""
    with listen("127.0.0.1", 0) as listener:
        server = server_of(application(open_system(), VIEW, LOOPBACK, None))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        while not server.started:
            time.sleep(0.1)
        with sync_playwright() as playwright:
            chromium = os.environ.get("CHROMIUM") or shutil.which("chromium")
            browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1400, "height": 900})
            page.goto(f"http://127.0.0.1:{listener.getsockname()[1]}/")
            page.wait_for_selector("#path path.down", timeout=120_000)
            page.wait_for_selector("#map text")
            page.screenshot(path=TARGET, full_page=True)
            browser.close()
        server.should_exit = True
        thread.join()


if __name__ == "__main__":
    main()
