"""The style sheet of a report: screen, phone, dark and paper.

Contrasts are those of WCAG 2.1, AA, in both colour schemes (a test computes them from the properties of `:root`).
"""

_CARDS = """
  table.cards, table.cards tbody, table.cards tr { display: block; }
  table.cards thead { display: none; }
  table.cards caption { display: block; }
  table.cards tr { display: grid; grid-template-columns: repeat(auto-fill, minmax(9rem, 1fr)); gap: 0 1rem;
    border-bottom: 2px solid var(--line); padding: .35rem 0; }
  table.cards tbody th { grid-column: 1 / -1; font-weight: 600; border: 0; }
  table.cards td { border: 0; text-align: left; padding: .1rem 0; white-space: normal; }
  table.cards td::before { content: attr(data-heading); display: block; color: var(--soft); font-size: .85em; }
  table.cards td:empty { display: none; }
"""
"""Of a table, each row as a card."""
_PAGE = """
:root {
  --paper: #ffffff; --ink: #1b1f24; --soft: #57606a; --line: #d0d7de; --band: #f6f8fa;
  --link: #0b57d0; --good: #116329; --bad: #a40e26; --note: #7a4b00;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14171c; --ink: #e6e9ee; --soft: #a6b0bb; --line: #3a424c; --band: #1d2228;
    --link: #8ab4f8; --good: #6fd08c; --bad: #ff9aa2; --note: #f0c36d;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; text-size-adjust: 100%; }
body {
  margin: 0 auto; padding: 1.5rem 1.25rem 3rem; max-width: 78rem;
  color: var(--ink); background: var(--paper);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Liberation Sans", sans-serif;
  overflow-wrap: break-word;
}
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .25rem; }
h2 { font-size: 1.25rem; line-height: 1.3; margin: 1.75rem 0 .5rem; border-bottom: 1px solid var(--line); }
h3 { font-size: 1.05rem; margin: 1.75rem 0 .5rem; }
h4 { font-size: 1rem; margin: 0 0 .5rem; }
p { margin: .5rem 0; max-width: 48rem; }
a { color: var(--link); }
.soft { color: var(--soft); }
.verdict { border-left: .35rem solid var(--soft); padding: .5rem .9rem; background: var(--band); max-width: none; }
.verdict strong { text-transform: uppercase; letter-spacing: .03em; margin-right: .35rem; }
.good { border-color: var(--good); } .good strong { color: var(--good); }
.bad { border-color: var(--bad); } .bad strong { color: var(--bad); }
.note { border-color: var(--note); } .note strong { color: var(--note); }
nav ul { list-style: none; display: flex; flex-wrap: wrap; gap: .25rem 1.1rem; margin: 1rem 0 0; padding: 0; }
.scroll { overflow-x: auto; margin: .75rem 0; max-width: 100%; }
.scroll:focus-visible, pre:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
table { border-collapse: collapse; font-size: .9rem; line-height: 1.4; }
caption { text-align: left; color: var(--soft); padding: 0 0 .35rem; }
th, td { text-align: left; vertical-align: top; padding: .25rem .9rem .25rem 0; border-bottom: 1px solid var(--line); }
thead th { color: var(--soft); font-weight: 600; border-bottom-width: 2px; }
tbody th { font-weight: 400; min-width: 9rem; }
td.long { overflow-wrap: anywhere; min-width: 7rem; }
.number { text-align: right; font-variant-numeric: tabular-nums; }
td.number { white-space: nowrap; }
td small { display: block; color: var(--soft); font-size: .85em; }
ul.tight { margin: .5rem 0; padding-left: 1.2rem; }
table.cards { width: 100%; }
table.cards td, table.cards th { padding-right: .6rem; }
table.cards thead th { vertical-align: bottom; line-height: 1.25; }
table.cards td > b { white-space: nowrap; }
table.cards b { color: var(--ink); } table.cards b.good { color: var(--good); }
table.cards b.bad { color: var(--bad); } table.cards b.note { color: var(--note); }
summary { font-weight: 600; }
details { border-bottom: 1px solid var(--line); }
details[open] { padding-bottom: 1rem; }
summary { cursor: pointer; padding: .45rem 0; }
summary h2 { display: inline; border: 0; margin: 0; font-size: 1.05rem; font-weight: 600; }
summary:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
details > div { scroll-margin-top: 3rem; }
pre, code { font: .86rem/1.45 ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace; }
pre { background: var(--band); padding: .6rem .8rem; overflow-x: auto; margin: .5rem 0; }
figure { margin: 1rem 0; }
figure img { display: block; max-width: min(100%, 48rem); height: auto; background: #ffffff; }
figcaption { font-size: .9rem; color: var(--soft); margin-top: .4rem; max-width: 48rem; }
figcaption strong { color: var(--ink); }
.pair {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 19rem), 1fr)); gap: 0 1.5rem;
  align-items: start;
}
.hands {
  display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 16rem), 1fr)); gap: 0 1.25rem;
  align-items: start;
}
.hands > p { grid-column: 1 / -1; margin: 0; font-size: .9rem; }
.hands figure { margin: .5rem 0; }
.beside { display: grid; grid-template-columns: minmax(0, 1fr); gap: 0 2rem; align-items: start; }
@media (min-width: 74rem) {
  .beside { grid-template-columns: minmax(0, 47rem) minmax(0, 1fr); }
}
article + article { border-top: 1px solid var(--line); padding-top: .9rem; margin-top: 1.25rem; }
footer { margin-top: 3rem; border-top: 1px solid var(--line); color: var(--soft); font-size: .9rem; }
CARDS
@media screen and (max-width: 30rem) {
  table:not(.cards) :is(th, td) { padding-right: .5rem; }
  table:not(.cards) tbody th { min-width: 6rem; }
}
@media (max-width: 30rem) {
  body { padding: 1rem .9rem 2rem; }
  h1 { font-size: 1.4rem; }
}
@media print {
  @page { size: A4; margin: 16mm 15mm 18mm; }
  :root { --paper: #ffffff; --ink: #000000; --soft: #444444; --line: #bbbbbb; --band: #f4f4f4; --link: #000000;
    --good: #116329; --bad: #a40e26; --note: #7a4b00; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  h1 { font-size: 17pt; } h2 { font-size: 13pt; margin-top: 7mm; } h3 { font-size: 11pt; }
  table { font-size: 8.5pt; } figcaption, caption, footer { font-size: 9pt; }
  pre, code { font-size: 8.5pt; white-space: pre-wrap; overflow-wrap: anywhere; }
  nav { display: none; }
  details:not([open]) { display: none; }
  summary { list-style: none; padding: 0; } summary h2 { font-size: 13pt; }
  table.cards { font-size: 8pt; } td small { font-size: 7pt; }
  h2, h3, h4, caption { break-after: avoid; }
  figure, article, tr, .verdict { break-inside: avoid; }
  .pair { grid-template-columns: 1fr 1fr; }
  thead { display: table-header-group; break-after: avoid; }
  .scroll { overflow: visible; break-inside: avoid; }
  td.long { min-width: 0; }
  article th, article td { padding-top: .5pt; padding-bottom: .5pt; }
  article figure { margin: 0; }
  p, figcaption { orphans: 3; widows: 3; }
  /* A figure is as large as it was drawn, whichever of its two pictures the screen had: 200 of its dots are an inch
     of 96 pixels. */
  figure img { max-width: 100%; max-height: 469mm; width: auto; zoom: .48; }
  #figure-hand img { max-width: 75%; }
  .hands { grid-template-columns: repeat(3, 1fr); }
  a[href^="http"]::after { content: " (" attr(href) ")"; }
}
"""
# A table of many results is wider than the page long before one of two is.
STYLE = _PAGE.replace(
    "CARDS\n",
    f"@media screen and (max-width: 54rem) {{{_CARDS}}}\n"
    f"@media screen and (max-width: 70rem) {{{_CARDS.replace('.cards', '.cards.many')}}}\n",
)
"""CSS."""
