// Wide tables and formulas scroll by themselves: give the keyboard a way to them (mkdocs.yml).
window.addEventListener("load", () => {
  for (const box of document.querySelectorAll(".md-typeset__scrollwrap, .arithmatex, .md-typeset pre > code, .md-typeset table")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
  }
});
// A word that begins with - is excluded by the search; options begin so (--max-error): they are searched without it.
document.querySelector(".md-search__input")?.addEventListener("input", (event) => {
  const bare = event.target.value.replace(/(^|\s)-+(?=\w)/g, "$1");
  if (bare !== event.target.value) event.target.value = bare;
});
