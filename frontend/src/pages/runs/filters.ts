/** The form beside the search box: what it says as a search. Pure. */

export interface Filters {
  readonly kind: string;
  readonly end: string;
  readonly verdict: string;
  readonly tag: string;
  /** A station's name; ALL_STATIONS for all, "" for the one of this service. */
  readonly station: string;
  /** Days of the person's own zone as the boxes have them, 2026-03-31, or "". */
  readonly from: string;
  readonly to: string;
}

export const ALL_STATIONS = "*";
/** A search that names a station looks at all of them, and this fits each. */
const ANY_STATION = 'station ~ ""';
export const NO_FILTERS: Filters = { kind: "", end: "", verdict: "", tag: "", station: "", from: "", to: "" };

/** The search that the form is, "" where it is empty. */
export function whereOf(filters: Filters): string {
  const { kind, end, verdict, tag, station, from, to } = filters;
  const terms = [
    kind && `kind = ${quoted(kind)}`,
    end && `end = ${quoted(end)}`,
    verdict && `verdict = ${quoted(verdict)}`,
    tag && `tag = ${quoted(tag)}`,
    station && (station === ALL_STATIONS ? ANY_STATION : `station = ${quoted(station)}`),
    from && `date >= ${midnight(from, 0)}`,
    to && `date < ${midnight(to, 1)}`,
  ];
  return terms.filter((term) => typeof term === "string" && term !== "").join(" ");
}

/** Form and box in one, to be saved under a name. */
export function together(typed: string, filters: Filters): string {
  const form = whereOf(filters);
  const box = typed.trim();
  return form === "" || box === "" ? box || form : `(${box}) ${form}`;
}

/** Where a day begins, or one `days` later, in UTC as searches have it; what is no date is left to be refused. */
function midnight(day: string, days: number): string {
  const begin = new Date(`${day}T00:00`);
  if (Number.isNaN(begin.getTime())) return day;
  begin.setDate(begin.getDate() + days);
  return begin.toISOString().slice(0, 16);
}

function quoted(text: string): string {
  return `"${text.replace(/["\\]/g, "\\$&")}"`;
}
