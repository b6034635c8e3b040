/** Verdict and key figure of a run in a list. */

import { Shown } from "../../components/Absent";
import { Explained } from "../../components/Explained";
import { Verdict } from "../../components/Verdict";
import { measured } from "../../samples/format";
import { readingOf, told, withUnit } from "../../samples/quantity";
import { heading } from "../../samples/words";
import { useAngles } from "../../service/angles";
import { entryOf } from "../../service/glossary";
import type { Run } from "../../wire/types";
import styles from "./Runs.module.css";

type Judged = Pick<Run, "outcome" | "end_state">;

/** How a run counts; a kind of run without criteria is not judged. */
export function RunVerdict({ run: { outcome, end_state } }: { run: Judged }) {
  const why = end_state === "running" ? "the run is not over" : "recorded by hand: nothing is judged";
  return (
    <Shown value={outcome} why={why}>
      {(found) =>
        found === "neutral" ? (
          <Explained of="outcome:neutral" quiet>
            Not judged
          </Explained>
        ) : (
          <Verdict good={found === "passed"} of={`outcome:${found}`}>
            {heading(found)}
          </Verdict>
        )
      }
    </Shown>
  );
}

/** The figure that decided, with its bound; the first one measured where nothing is judged. */
export function KeyFigure({ headline }: Pick<Run, "headline">) {
  const angles = useAngles();
  return (
    <Shown value={headline} why="no figure was measured">
      {({ name, label, value, unit, relation, bound }) => {
        const reading = readingOf(unit, angles);
        return (
          <span className={styles.key}>
            <Explained of={entryOf(`figure:${name}`) ?? entryOf(`quantity:${name}`)}>{label}</Explained>
            <span className={styles.keyValue}>
              {withUnit(measured(value * reading.factor, 3), reading.unit)}
            </span>
            {bound !== null && (
              <span className={styles.bound}>
                {relation} {told(bound, unit, angles)}
              </span>
            )}
          </span>
        );
      }}
    </Shown>
  );
}
