"""How tests open a page and wait for it."""

ARGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
LAPTOP, PHONE = {"width": 1280, "height": 720}, {"width": 390, "height": 844}


def settled(tab):
    """Wait until the last change is drawn, sharply."""
    tab.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))")
    until(tab, "!trunkPage.stage?.coarse")
    tab.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 0)))")


def until(tab, condition):
    """Wait for a condition; the page's security policy forbids playwright's own way."""
    tab.evaluate(
        f"""() => new Promise((done) => {{
          const look = () => ({condition} ? done() : requestAnimationFrame(look));
          look();
        }})"""
    )


def picture(tab):
    settled(tab)
    return tab.locator("#canvas").screenshot()
