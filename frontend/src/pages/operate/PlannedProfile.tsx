/** All that a program will ask for, with the line of now: what has been, and what is ahead. */

import { useQuery } from "@tanstack/react-query";
import { SignalName } from "../../components/SignalName";
import { fixed } from "../../samples/format";
import { readingOf } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { plannedQuery } from "../../service/queries";
import { HUES } from "../../theme/signals";
import type { Planned } from "../../wire/types";
import styles from "./PlannedProfile.module.css";
import { HEIGHT, lineOf, momentOf, WIDTH } from "./plannedLines";

/** Samples are stored once a second. */
const STORED_AFTER_S = 2;

export function PlannedProfile({ run, at_s }: { run: number; at_s: number }) {
  const { data } = useQuery(plannedQuery(run, at_s > STORED_AFTER_S));
  const angle = readingOf("rad", useAngles());
  if (data === undefined || data.t.length === 0) return null;
  const now = momentOf(data, at_s);
  return (
    <figure className={styles.profile} aria-label="Planned profile">
      <Row
        planned={data}
        values={data.q_ref.map((value) => value * angle.factor)}
        name="q_ref"
        unit={angle.unit}
        hue={HUES.q}
        now={now.q_ref * angle.factor}
        x={now.x}
      />
      <Row
        planned={data}
        values={data.S_ref}
        name="S_ref"
        unit="N·m/rad"
        hue={HUES.S}
        now={now.S_ref}
        x={now.x}
      />
    </figure>
  );
}

interface RowProps {
  readonly planned: Planned;
  readonly values: readonly number[];
  readonly name: string;
  readonly unit: string;
  readonly hue: string;
  readonly now: number;
  readonly x: number;
}

function Row({ planned, values, name, unit, hue, now, x }: RowProps) {
  const { points, lowest, highest } = lineOf(planned.t, values);
  const whole_s = planned.t[planned.t.length - 1] ?? 1;
  return (
    <div className={styles.row}>
      <span className={styles.name}>
        <SignalName name={name} /> [{unit}]
      </span>
      <svg
        className={styles.picture}
        viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`${name} from ${fixed(lowest, 1)} to ${fixed(highest, 1)} ${unit}, now ${fixed(now, 1)}`}
      >
        {planned.parts.slice(1).map((part) => (
          <line
            key={part.start_s}
            className={styles.part}
            x1={(WIDTH * part.start_s) / whole_s}
            x2={(WIDTH * part.start_s) / whole_s}
            y1="0"
            y2={HEIGHT}
          />
        ))}
        <rect className={styles.past} x="0" y="0" width={x} height={HEIGHT} />
        <polyline className={styles.line} points={points} stroke={hue} />
        <line className={styles.now} x1={x} x2={x} y1="0" y2={HEIGHT} />
      </svg>
      <span className={styles.range}>
        {fixed(highest, 1)}
        <br />
        {fixed(lowest, 1)}
      </span>
    </div>
  );
}
