/** Texts of the page Glossary. */
export const TEXTS = {
  title: "Glossary",
  lead: "All terms, symbols, metrics, verdicts and faults of this page. To see a definition in place, hover over or tap a dotted term, or focus it with the Tab key; the arrow keys go to the next term.",
  search: "Search",
  searchHint: "Symbol, word or unit",
  found: "Results",
} as const;
