/** The form beside the search box: what it says as a search. Pure. */

export interface Filters {
  readonly kind: string;
  readonly end: string;
  readonly verdict: string;
  readonly tag: string;
  /** A station's name; ALL_STATIONS for all, "" for the one of this service. */
  readonly station: string;
  /** Dates as the boxes have them, 2026-03-31, or "". */
  readonly from: string;
  readonly to: string;
}

export const ALL_STATIONS = "*";
export const NO_FILTERS: Filters = { kind: "", end: "", verdict: "", tag: "", station: "", from: "", to: "" };

/** The search that the form is, "" where it is empty. */
export function whereOf(filters: Filters): string {
  const { kind, end, verdict, tag, station, from, to } = filters;
  const terms = [
    kind && `kind = ${quoted(kind)}`,
    end && `end = ${quoted(end)}`,
    verdict && `verdict = ${quoted(verdict)}`,
    tag && `tag = ${quoted(tag)}`,
    station && station !== ALL_STATIONS && `station = ${quoted(station)}`,
    from && `date >= ${from}`,
    to && `date <= ${to}`,
  ];
  return terms.filter((term) => typeof term === "string" && term !== "").join(" ");
}

/** Form and box in one, to be saved under a name. */
export function together(typed: string, filters: Filters): string {
  const form = whereOf(filters);
  const box = typed.trim();
  return form === "" || box === "" ? box || form : `(${box}) ${form}`;
}

function quoted(text: string): string {
  return `"${text.replace(/["\\]/g, "\\$&")}"`;
}
