import type { ReactNode } from "react";
import { MINUS } from "../samples/format";
import { localizeText, readingNear } from "../samples/quantity";
import { useAngleUnit } from "../service/api/preferences";
import { entryOf, symbolEntries } from "../service/glossary";
import { Explained } from "./Explained";
import styles from "./Metric.module.css";
import { TEXTS } from "./texts";

/** A text of the service, with the angles in it as this person reads them. */

export function LocalizedText({ text }: { text: string }) {
  return <>{localizeText(text, useAngleUnit())}</>;
}

/** A signal's name as it is written in the paper: q_ref with a lowered "ref"; it says what it means when asked. */

/** Letters that a column's name has to spell out. */
const GREEK: Record<string, string> = { theta: "θ", lam: "λ" };

/** The name alone, where something around it explains it, or is a control; of a difference those of both. */
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

/** What stands where there is no value: the one dash of the page, which cannot be had without its reason. */

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
export function ValueOrReason<Value>({ value, why, children }: ShownProps<Value>) {
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

/** The unit of a row, as this person reads it. */

/** `near` is the figure of the row in SI, whose prefix the unit takes. */
export function Unit({ unit, near = 1 }: { unit: string; near?: number | undefined }) {
  const angles = useAngleUnit();
  return unit === "1" || unit === "" ? <Absent why={TEXTS.noUnit} /> : readingNear(near, unit, angles).unit;
}

/** A small reading: what above, how much below, in a width that does not change with the digits. */

interface MetricProps {
  /** What is measured: a key of the glossary, which also says what it is called. */
  readonly of: string;
  readonly value: ReactNode;
  readonly width: string;
  /** Left out where there is little room. */
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
