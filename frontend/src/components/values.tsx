import type { ReactNode } from "react";
import { MINUS } from "../samples/format";
import { localizeText, readingNear } from "../samples/quantity";
import { useAngleUnit } from "../service/api/preferences";
import { entryOf, symbolEntries } from "../service/glossary";
import { Explained } from "./Explained";
import styles from "./Metric.module.css";
import { TEXTS } from "./texts";

/** Text of the service with quantities in the person's units. */

export function LocalizedText({ text }: { text: string }) {
  return <>{localizeText(text, useAngleUnit())}</>;
}

/** Name of a signal in the paper's notation: q_ref with a lowered "ref", and its explanation. */

/** Letters that the names of columns spell out. */
const GREEK: Record<string, string> = { theta: "θ", lam: "λ" };

/** Symbol without explanation, within a control or an explained element; a difference has both symbols. */
export function SymbolText({ name }: { name: string }) {
  const [of, taken] = name.split(" - ");
  if (taken === undefined) return <Single name={name} />;
  return (
    <>
      <Single name={of as string} /> {MINUS} <Single name={taken} />
    </>
  );
}

function Single({ name }: { name: string }) {
  const [letter = "", ...index] = name.split("_");
  return (
    <span className="symbol">
      <i>{GREEK[letter] ?? letter}</i>
      {index.length > 0 && <sub>{index.join(",")}</sub>}
    </span>
  );
}

export function SignalName({ name }: { name: string }) {
  return (
    <Explained of={symbolEntries(name)}>
      <SymbolText name={name} />
    </Explained>
  );
}

/** Dash for a missing value, which always has a reason. */

const DASH = "–";

interface AbsentProps {
  /** Reason, for the title and for screen readers: "nothing is staged". */
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

/** Value as `children` format it, or the dash with the reason; NaN counts as missing. */
export function ValueOrReason<Value>({ value, why, children }: ShownProps<Value>) {
  const absent = value === null || value === undefined || Number.isNaN(value);
  return absent ? <Absent why={why} /> : children(value);
}

/** The same for text that code writes directly into an element. */
export function writeAbsent(into: HTMLElement, why: string): void {
  if (into.title === why) return;
  into.textContent = DASH;
  into.title = why;
  into.setAttribute("role", "img");
  into.setAttribute("aria-label", why);
}

/** Writes a text, and removes the reason of a missing value. */
export function writeValue(into: HTMLElement, text: string): void {
  if (into.hasAttribute("role"))
    for (const name of ["title", "role", "aria-label"]) into.removeAttribute(name);
  if (into.textContent !== text) into.textContent = text;
}

/** Unit of a row in the person's units. */

/** `near`: value of the row in SI, which determines the prefix of the unit. */
export function Unit({ unit, near = 1 }: { unit: string; near?: number | undefined }) {
  const angles = useAngleUnit();
  return unit === "1" || unit === "" ? <Absent why={TEXTS.noUnit} /> : readingNear(near, unit, angles).unit;
}

/** Small reading: label above, value below, in a width that does not depend on the digits. */

interface MetricProps {
  /** Key of the glossary, whose entry also contains the label. */
  readonly of: string;
  readonly value: ReactNode;
  readonly width: string;
  /** Hidden if there is little space. */
  readonly optional?: boolean;
}

export function Metric({ of, value, width, optional = false }: MetricProps) {
  return (
    <span className={styles.metric} data-optional={optional} style={{ minWidth: width }}>
      <span className={styles.label}>
        <Explained of={of}>{entryOf(of)?.term}</Explained>
      </span>
      <span className={styles.value}>{value}</span>
    </span>
  );
}
