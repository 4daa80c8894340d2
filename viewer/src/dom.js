// Elements of the page.
export const $ = (id) => document.getElementById(id);

// Text goes in as text: names may hold anything.
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

export const button = (id, text, key, act) => element("button", { id, type: "button", onclick: act }, text, element("kbd", { textContent: key }));
