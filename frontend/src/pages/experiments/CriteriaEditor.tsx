/** Bounds of an own experiment that its runs are judged by. */

import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { TbPlus, TbX } from "react-icons/tb";
import { labelWith } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { useRefusedInput, useRefusedWithin } from "../../service/refusedFields";
import type { Metric } from "../../wire/types";
import page from "../Page.module.css";
import type { Bound } from "./document";
import { ExpressionField } from "./ExpressionField";
import styles from "./SequenceEditor.module.css";

interface CriteriaEditorProps {
  readonly criteria: readonly Bound[];
  /** What the last preview measured: these can be bounded. */
  readonly metrics: readonly Metric[];
  onChange(criteria: readonly Bound[]): void;
}

export function CriteriaEditor({ criteria, metrics, onChange }: CriteriaEditorProps) {
  const named = new Set(criteria.map(({ figure }) => figure));
  const further = metrics.find(({ name }) => !named.has(name))?.name ?? "min_tension_N";
  return (
    <fieldset className={`${styles.phase} ${page.fields}`}>
      <legend>Criteria</legend>
      {criteria.map((bound, index) => (
        <Row
          // biome-ignore lint/suspicious/noArrayIndexKey: a criterion is its place in the list
          key={index}
          index={index}
          bound={bound}
          metrics={metrics}
          onChange={(next) => onChange(criteria.with(index, next))}
          onRemove={() => onChange(criteria.toSpliced(index, 1))}
        />
      ))}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          onClick={() => onChange([...criteria, { figure: further, below: 1 }])}
        >
          Add criterion
        </Button>
      </div>
    </fieldset>
  );
}

interface RowProps {
  readonly index: number;
  readonly bound: Bound;
  readonly metrics: readonly Metric[];
  onChange(bound: Bound): void;
  onRemove(): void;
}

function Row({ index, bound, metrics, onChange, onRemove }: RowProps) {
  const angles = useAngles();
  const place = `criteria.${index}`;
  const saidAt = `criterion-${index}-refused`;
  const { ref, said } = useRefusedInput<HTMLSelectElement>(place, saidAt);
  const within = useRefusedWithin(place);
  const whose = `of criterion ${index + 1}`;
  const { figure, name, title } = bound;
  const unit = metrics.find((metric) => metric.name === figure)?.unit ?? "1";
  const side = bound.above === undefined ? "below" : "above";
  const value = bound[side];
  const known = metrics.map((metric) => ({
    value: metric.name,
    label: labelWith(metric.label, metric.unit, angles),
  }));
  const rest = { figure, ...(name === undefined ? {} : { name }), ...(title ? { title } : {}) };
  return (
    <div>
      <div className={styles.criterion}>
        <NativeSelect
          ref={ref}
          size="xs"
          label="Figure"
          aria-label={`Figure ${whose}`}
          error={said !== null}
          data={
            known.some((one) => one.value === figure) ? known : [{ value: figure, label: figure }, ...known]
          }
          value={figure}
          onChange={(event) => onChange({ [side]: value, figure: event.currentTarget.value })}
        />
        <NativeSelect
          size="xs"
          label="Stays"
          aria-label={`Stays ${whose}`}
          data={["below", "above"]}
          value={side}
          onChange={(event) => onChange({ ...rest, [event.currentTarget.value]: value })}
        />
        <ExpressionField
          words="Bound"
          unit={unit}
          whose={whose}
          value={value}
          place={`${place}.${side}`}
          saidAt={saidAt}
          onChange={(next) => onChange({ ...rest, [side]: next ?? "" })}
        />
        <TextInput
          size="xs"
          label="Title"
          aria-label={`Title ${whose}`}
          placeholder="as the figure"
          value={title ?? ""}
          onChange={(event) => onChange({ ...bound, title: event.currentTarget.value })}
        />
        <ActionIcon
          variant="subtle"
          color="gray"
          size={24}
          mb={4}
          aria-label={`Remove criterion ${index + 1}`}
          onClick={onRemove}
        >
          <TbX size={14} />
        </ActionIcon>
      </div>
      {(said ?? within) !== null && (
        <div id={saidAt} role="alert" className={styles.refused}>
          {said ?? within}
        </div>
      )}
    </div>
  );
}
