/** What the composer was opened with, and whether somebody has saved another version since. Pure. */

import type { OwnExperiment } from "../../wire/types";
import { asDocument } from "./document";

export interface Opened {
  readonly text: string;
  /** What the text says as plain data, as the service read it; null where the text is JSON or nothing. */
  readonly document: unknown;
  /** Name of the own experiment; empty for anything else. */
  readonly name: string;
  /** Newest version under this name when it was opened. */
  readonly newest: number;
  /** Of a run that was made an experiment: what of it the experiment does not repeat. */
  readonly leftOut: readonly string[];
}

export const NOTHING_OPENED: Opened = { text: "", document: null, name: "", newest: 0, leftOut: [] };

/** Whether stored data is what this version of the page stores. */
export function isOpened(value: unknown): value is Opened {
  if (typeof value !== "object" || value === null) return false;
  const { text, document, name, newest, leftOut } = value as Record<string, unknown>;
  return (
    typeof text === "string" &&
    (document === null || asDocument(document) !== null) &&
    typeof name === "string" &&
    typeof newest === "number" &&
    Array.isArray(leftOut)
  );
}

/** What to ask before a text is kept under a name; null where nobody has kept another version since it was opened. */
export function savedMeanwhile(
  opened: Opened,
  name: string,
  versions: readonly OwnExperiment[],
): string | null {
  const newest = versions[0];
  if (newest === undefined) return null;
  const known = opened.name === name ? opened.newest : 0;
  if (newest.version <= known) return null;
  const when =
    known === 0
      ? `${name} exists already: ${newest.who} kept version ${newest.version}.`
      : `${newest.who} kept version ${newest.version} of ${name} after this was opened.`;
  return `${when} Keep adds version ${newest.version + 1}; version ${newest.version} stays as it is.`;
}
