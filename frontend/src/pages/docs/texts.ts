/** Texts of the page Docs. */
export const TEXTS = {
  title: "Docs",
  documents: "Documents",
  search: "Search all documents",
  searchHint: "tension, homing, λ_q …",
  byPurpose: "Documents by purpose",
  tutorial: "Tutorial",
  howTo: "How-to guides",
  reference: "Reference",
  explanation: "Explanation",
  project: "Project",
  decisions: "Design decisions",
  found: "Results",
  foundFirst: "{sections}, first {shown} shown",
  titleOfSection: "{document}: {section}",
  notFound: "Document “{name}” does not exist. Choose one from the list.",
  table: "Table: {columns}",
} as const;
