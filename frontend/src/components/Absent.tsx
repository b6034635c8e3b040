/** What stands where there is no value: the one dash of the page, which cannot be had without its reason. */

import type { ReactNode } from "react";

const DASH = "–";

interface AbsentProps {
  /** Why there is none, for who points at it or has it read out: "nothing is staged". */
  readonly why: string;
}

export function Absent({ why }: AbsentProps) {
  return (
    <span role="img" aria-label={why} title={why}>
      {DASH}
    </span>
  );
}

interface ShownProps<Value> extends AbsentProps {
  readonly value: Value | null | undefined;
  readonly children: (value: Value) => ReactNode;
}

/** A value as `children` write it, or that there is none; a number that is none counts as absent. */
export function Shown<Value>({ value, why, children }: ShownProps<Value>) {
  const absent = value === null || value === undefined || Number.isNaN(value);
  return absent ? <Absent why={why} /> : children(value);
}

/** The same for what is written straight into the page. */
export function writeAbsent(into: HTMLElement, why: string): void {
  if (into.title === why) return;
  into.textContent = DASH;
  into.title = why;
  into.setAttribute("role", "img");
  into.setAttribute("aria-label", why);
}

/** Takes the reason away again, with what stood for it. */
export function writeValue(into: HTMLElement, text: string): void {
  if (into.hasAttribute("role"))
    for (const name of ["title", "role", "aria-label"]) into.removeAttribute(name);
  if (into.textContent !== text) into.textContent = text;
}
