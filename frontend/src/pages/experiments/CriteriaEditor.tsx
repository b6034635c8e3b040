import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { useState } from "react";
import { TbPlus, TbX } from "react-icons/tb";
import { boxText, inSI, labelWith } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useAngleUnit } from "../../service/api/preferences";
import { useRefusedInput, useRefusedWithin } from "../../service/forms/refusals";
import type { Metric } from "../../wire/types";
import page from "../Page.module.css";
import type { Bound, Value } from "./document";
import styles from "./SequenceEditor.module.css";
import { TEXTS } from "./texts";

interface ExpressionFieldProps {
  readonly words: string;
  readonly unit: string;
  /** Owner of the field, for screen readers: "of part 1.2". */
  readonly whose: string;
  readonly value: Value | undefined;
  readonly place: string;
  readonly messageId: string;
  readonly optional?: boolean | undefined;
  onChange(value: number | string | undefined): void;
}

export function ExpressionField(props: ExpressionFieldProps) {
  const { words, unit, whose, value, place, messageId, optional, onChange } = props;
  const angles = useAngleUnit();
  const [typed, setTyped] = useState<string | null>(null);
  const { ref, said } = useRefusedInput<HTMLInputElement>(place, messageId);
  const label = labelWith(words, unit, angles);
  const shown = typeof value === "number" ? boxText(value, unit, angles) : String(value ?? "");
  const expression = typeof value === "string" && value.trim() !== "";
  return (
    <TextInput
      label={label}
      aria-label={fillText(TEXTS.labelOf, { label, owner: whose })}
      ref={ref}
      size="xs"
      autoComplete="off"
      placeholder={optional ? TEXTS.unchanged : undefined}
      value={typed ?? shown}
      error={said !== null || (value === undefined && !optional)}
      rightSection={
        expression ? (
          <span title={unit === "1" ? TEXTS.expressionInSI : fillText(TEXTS.expressionIn, { unit })}>ƒ</span>
        ) : null
      }
      rightSectionWidth={expression ? 18 : 0}
      onChange={(event) => {
        const text = event.currentTarget.value;
        setTyped(text);
        onChange(text.trim() === "" ? undefined : (inSI(text, unit, angles) ?? text));
      }}
      onBlur={() => setTyped(null)}
    />
  );
}

interface CriteriaEditorProps {
  readonly criteria: readonly Bound[];
  /** Metrics of the last preview, for which bounds can be set. */
  readonly metrics: readonly Metric[];
  onChange(criteria: readonly Bound[]): void;
}

export function CriteriaEditor({ criteria, metrics, onChange }: CriteriaEditorProps) {
  const named = new Set(criteria.map(({ figure }) => figure));
  const further = metrics.find(({ name }) => !named.has(name))?.name ?? "min_tension_N";
  return (
    <fieldset className={`${styles.phase} ${page.fields}`}>
      <legend>{TEXTS.criteria}</legend>
      {criteria.map((bound, index) => (
        <Row
          // biome-ignore lint/suspicious/noArrayIndexKey: a criterion is identified by its position in the list
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
          {TEXTS.addCriterion}
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
  const angles = useAngleUnit();
  const place = `criteria.${index}`;
  const messageId = `criterion-${index}-refused`;
  const { ref, said } = useRefusedInput<HTMLSelectElement>(place, messageId);
  const within = useRefusedWithin(place);
  const whose = fillText(TEXTS.ofCriterion, { number: index + 1 });
  const labelOf = (label: string) => fillText(TEXTS.labelOf, { label, owner: whose });
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
          label={TEXTS.metric}
          aria-label={labelOf(TEXTS.metric)}
          error={said !== null}
          data={
            known.some((one) => one.value === figure) ? known : [{ value: figure, label: figure }, ...known]
          }
          value={figure}
          onChange={(event) => onChange({ [side]: value, figure: event.currentTarget.value })}
        />
        <NativeSelect
          size="xs"
          label={TEXTS.condition}
          aria-label={labelOf(TEXTS.condition)}
          data={[
            { value: "below", label: TEXTS.below },
            { value: "above", label: TEXTS.above },
          ]}
          value={side}
          onChange={(event) => onChange({ ...rest, [event.currentTarget.value]: value })}
        />
        <ExpressionField
          words={TEXTS.bound}
          unit={unit}
          whose={whose}
          value={value}
          place={`${place}.${side}`}
          messageId={messageId}
          onChange={(next) => onChange({ ...rest, [side]: next ?? "" })}
        />
        <TextInput
          size="xs"
          label={TEXTS.criterionTitle}
          aria-label={labelOf(TEXTS.criterionTitle)}
          placeholder={TEXTS.criterionTitleHint}
          value={title ?? ""}
          onChange={(event) => onChange({ ...bound, title: event.currentTarget.value })}
        />
        <ActionIcon
          variant="subtle"
          color="gray"
          size={24}
          mb={4}
          aria-label={fillText(TEXTS.removeCriterion, { number: index + 1 })}
          onClick={onRemove}
        >
          <TbX size={14} />
        </ActionIcon>
      </div>
      {(said ?? within) !== null && (
        <div id={messageId} role="alert" className={styles.refused}>
          {said ?? within}
        </div>
      )}
    </div>
  );
}
