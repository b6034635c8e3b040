/** All that a program will ask for, with the line of now: what has been, and what is ahead. */

import { useQuery } from "@tanstack/react-query";
import { SignalName } from "../../components/SignalName";
import { fixed } from "../../samples/format";
import { readingOf, withUnit } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { plannedQuery } from "../../service/queries";
import { paintOf, traceFor } from "../../theme/signals";
import type { Planned } from "../../wire/types";
import styles from "./PlannedProfile.module.css";
import { HEIGHT, lineOf, placeOf, valueAt, WIDTH } from "./plannedLines";

/** Samples are stored once a second. */
const STORED_AFTER_S = 2;

export function PlannedProfile({ run, at_s }: { run: number; at_s: number }) {
  const { data } = useQuery(plannedQuery(run, at_s > STORED_AFTER_S));
  if (data === undefined || data.t.length === 0) return null;
  return (
    <figure className={styles.profile} aria-label="Planned profile">
      {data.lines.map((line) => (
        <Row key={line.name} planned={data} line={line} at_s={at_s} />
      ))}
    </figure>
  );
}

interface RowProps {
  readonly planned: Planned;
  readonly line: Planned["lines"][number];
  readonly at_s: number;
}

function Row({ planned, line: { name, unit: inSI, values }, at_s }: RowProps) {
  const { unit, factor } = readingOf(inSI, useAngles());
  const { pieces, lowest, highest } = lineOf(
    planned.t,
    values.map((value) => (value === null ? null : value * factor)),
  );
  const now = valueAt(planned.t, values, at_s);
  const x = placeOf(planned.t, at_s);
  const whole_s = planned.t[planned.t.length - 1] ?? 1;
  const { hue } = traceFor(name, []);
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
        aria-label={`${name} from ${fixed(lowest, 1)} to ${withUnit(fixed(highest, 1), unit)}, now ${now === null ? "left open" : withUnit(fixed(now * factor, 1), unit)}`}
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
        {pieces.map((points) => (
          <polyline key={points.slice(0, 20)} className={styles.line} points={points} stroke={paintOf(hue)} />
        ))}
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
