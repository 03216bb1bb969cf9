// Elements of the page.

export function byId(id) {
  return document.getElementById(id);
}

/** Write text only if it differs, because writing costs time and screen readers may repeat it. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
