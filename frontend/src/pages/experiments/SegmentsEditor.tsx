/** Own sequence of references, one row per segment. */

import { ActionIcon, Button, NativeSelect } from "@mantine/core";
import { IconPlus, IconX } from "@tabler/icons-react";
import { NumberField } from "../../components/NumberField";
import { duration } from "../../samples/format";
import styles from "./SegmentsEditor.module.css";
import { further, parseSegments, type Segment, SHAPES, totalOf, writeSegments } from "./segments";

const COLUMNS = [
  { name: "duration_s", label: "Time [s]" },
  { name: "q_ref_deg", label: "q_ref [deg]" },
  { name: "S_ref", label: "S_ref [N·m/rad]" },
  { name: "F_push", label: "Push [N]" },
  { name: "period_s", label: "Period [s]" },
] as const;

interface SegmentsEditorProps {
  readonly json: string;
  onChange(json: string): void;
}

export function SegmentsEditor({ json, onChange }: SegmentsEditorProps) {
  const segments = parseSegments(json) ?? [];
  const send = (rows: readonly Segment[]) => onChange(writeSegments(rows));
  const total_s = totalOf(segments);

  return (
    <fieldset className={styles.editor}>
      <legend>Segments, {duration(total_s)}</legend>
      <div className={styles.row} aria-hidden="true">
        <span>Shape</span>
        {COLUMNS.map(({ label }) => (
          <span key={label}>{label}</span>
        ))}
      </div>
      {segments.map((segment, index) => (
        // biome-ignore lint/suspicious/noArrayIndexKey: a segment is its place in the sequence
        <div key={index} className={styles.row}>
          <NativeSelect
            aria-label={`Shape of segment ${index + 1}`}
            data={[...SHAPES]}
            value={segment.shape}
            onChange={(event) => {
              const shape = event.currentTarget.value as Segment["shape"];
              send(segments.with(index, { ...segment, shape }));
            }}
          />
          {COLUMNS.map(({ name, label }) => (
            <NumberField
              key={name}
              aria-label={`${label} of segment ${index + 1}`}
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
            <IconX size={14} />
          </ActionIcon>
        </div>
      ))}
      <Button
        variant="default"
        size="compact-xs"
        leftSection={<IconPlus size={13} />}
        onClick={() => send([...segments, further(segments)])}
      >
        Add segment
      </Button>
    </fieldset>
  );
}
