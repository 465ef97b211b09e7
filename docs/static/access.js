// What the theme leaves out for readers by ear and by keyboard.
addEventListener("DOMContentLoaded", () => {
  const each = (chosen, change) => document.querySelectorAll(chosen).forEach(change);
  const label = (node, text) => node.setAttribute("aria-label", text);
  each("[role=heading]:not([aria-level])", (node) => node.setAttribute("aria-level", "2"));
  each("aside.sidebar-drawer", (node) => label(node, "Pages"));
  each("aside.toc-drawer", (node) => label(node, "On this page"));
  each(".sphx-glr-thumbcontainer a", (node) => label(node, node.closest("div").innerText.trim()));
  // Parameters of a signature are no definitions.
  each("dt dl", (node) => (node.outerHTML = node.outerHTML.replace(/<(\/?)d[ld]\b/g, "<$1div")));
  if (!document.querySelector("h1")) {
    const heading = document.createElement("h1");
    heading.textContent = document.title;
    document.querySelector("article")?.prepend(heading);
  }
  // Wide tables and code scroll within the page: with the keyboard, too.
  each("pre, .table-wrapper", (node) => {
    if (node.scrollWidth > node.clientWidth || node.scrollHeight > node.clientHeight) node.tabIndex = 0;
  });
});
