/** Own sequence of references, one row per segment. */

import { ActionIcon, Button } from "@mantine/core";
import { Fragment } from "react";
import { TbPlus, TbX } from "react-icons/tb";
import { ChoiceField } from "../../components/ChoiceField";
import { NumberField } from "../../components/NumberField";
import { duration } from "../../samples/format";
import { labelWith } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { symbolEntry } from "../../service/glossary";
import { useRefusedWithin } from "../../service/refusedFields";
import styles from "./SegmentsEditor.module.css";
import {
  further,
  parseSegments,
  type Segment,
  SHAPES,
  segmentProblem,
  totalOf,
  writeSegments,
} from "./segments";

const COLUMNS = [
  { name: "duration_s", words: "Time", unit: "s" },
  { name: "q_ref", words: "q_ref", unit: "rad" },
  { name: "S_ref", words: "S_ref", unit: "N·m/rad" },
  { name: "F_push", words: "Push", unit: "N" },
  { name: "period_s", words: "Period", unit: "s" },
] as const;

interface SegmentsEditorProps {
  readonly json: string;
  onChange(json: string): void;
}

export function SegmentsEditor({ json, onChange }: SegmentsEditorProps) {
  const angles = useAngles();
  const segments = parseSegments(json) ?? [];
  const send = (rows: readonly Segment[]) => onChange(writeSegments(rows));
  const total_s = totalOf(segments);

  return (
    <fieldset className={styles.editor}>
      <legend>Segments, {duration(total_s)}</legend>
      <div className={styles.row} aria-hidden="true">
        <span>Shape</span>
        {COLUMNS.map(({ name, words, unit }) => (
          <span key={name}>{labelWith(words, unit, angles)}</span>
        ))}
      </div>
      {segments.map((segment, index) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: a segment is its place in the sequence
        <Fragment key={index}>
          <div className={styles.row}>
            <ChoiceField
              aria-label={`Shape of segment ${index + 1}`}
              data={[...SHAPES]}
              value={segment.shape}
              place={`segments.${index}.shape`}
              saidAt={`segment-${index}-refused`}
              onChange={(shape) =>
                send(segments.with(index, { ...segment, shape: shape as Segment["shape"] }))
              }
            />
            {COLUMNS.map(({ name, words, unit }) => (
              <NumberField
                key={name}
                aria-label={`${labelWith(words, unit, angles)} of segment ${index + 1}`}
                unit={unit}
                entry={symbolEntry(name)}
                place={`segments.${index}.${name}`}
                saidAt={`segment-${index}-refused`}
                disabled={name === "period_s" && segment.shape !== "sine"}
                value={segment[name]}
                onChange={(value) => send(segments.with(index, { ...segment, [name]: value }))}
              />
            ))}
            <ActionIcon
              variant="subtle"
              color="gray"
              aria-label={`Remove segment ${index + 1}`}
              disabled={segments.length === 1}
              onClick={() => send(segments.toSpliced(index, 1))}
            >
              <TbX size={14} />
            </ActionIcon>
          </div>
          <RowRefusal index={index} problem={segmentProblem(segment)} />
        </Fragment>
      ))}
      <Button
        variant="default"
        size="compact-xs"
        leftSection={<TbPlus size={13} />}
        onClick={() => send([...segments, further(segments)])}
      >
        Add segment
      </Button>
    </fieldset>
  );
}

/** Below the row, as the boxes are too narrow for a sentence. */
function RowRefusal({ index, problem }: { index: number; problem: string | null }) {
  const refused = useRefusedWithin(`segments.${index}`);
  const said = problem ?? refused;
  return said === null ? null : (
    <div id={`segment-${index}-refused`} role="alert" className={styles.refused}>
      {said}
    </div>
  );
}
