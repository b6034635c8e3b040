/** A signal's name as it is written in the paper: q_ref with a lowered "ref"; it says what it means when asked. */

import { MINUS } from "../samples/format";
import { symbolEntries } from "../service/glossary";
import { Explained } from "./Explained";

/** Letters that a column's name has to spell out. */
const GREEK: Record<string, string> = { theta: "θ", lam: "λ" };

/** The name alone, where something around it explains it, or is a control; of a difference those of both. */
export function Written({ name }: { name: string }) {
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
      <Written name={name} />
    </Explained>
  );
}
