/** A signal's name as it is written in the paper: q_ref with a lowered "ref"; it says what it means when asked. */

import { symbolEntry } from "../service/glossary";
import { Explained } from "./Explained";

/** The name alone, where something around it explains it, or is a control. */
export function Written({ name }: { name: string }) {
  const [letter, ...index] = name.split("_");
  return (
    <span className="symbol">
      <i>{letter}</i>
      {index.length > 0 && <sub>{index.join(",")}</sub>}
    </span>
  );
}

export function SignalName({ name }: { name: string }) {
  return (
    <Explained of={symbolEntry(name)}>
      <Written name={name} />
    </Explained>
  );
}
