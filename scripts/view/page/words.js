// Text of an element; setting what is there already would have the browser lay out and paint anew.
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
