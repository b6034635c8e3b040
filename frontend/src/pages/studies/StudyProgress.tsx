/** How far a study is: in words, and as a bar. */

import { Progress } from "@mantine/core";
import { duration, fixed } from "../../samples/format";
import { capital } from "../../samples/words";
import type { Study } from "../../wire/types";
import styles from "./Studies.module.css";

export function StudyProgress({ study }: { study: Study }) {
  const left = study.left_s === null ? "" : `, ${duration(study.left_s)} left`;
  return (
    <div className={styles.progress}>
      <Progress
        value={(100 * study.done) / study.points}
        aria-label={`Progress of study ${study.id}`}
        size="sm"
      />
      <span>
        {capital(study.state)}, {fixed(study.done, 0)} of {fixed(study.points, 0)} runs{left}
      </span>
    </div>
  );
}
