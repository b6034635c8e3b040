/** The form of a study: what is varied, the plants and the noise. It edits the document that the text says. */

import { ActionIcon, Button, NativeSelect, TextInput } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbPlus, TbX } from "react-icons/tb";
import { experimentKindsQuery } from "../../service/queries";
import page from "../Page.module.css";
import { AxisRows, NumberBox } from "./AxisRows";
import { SpreadRows } from "./SpreadRows";
import styles from "./StudyForm.module.css";
import type { StudyDocument, Value } from "./studyDocument";
import { VariedSelect } from "./VariedSelect";
import { type Choices, useVaried, variedOf } from "./varied";

interface StudyFormProps {
  readonly document: StudyDocument;
  onChange(document: StudyDocument): void;
}

export function StudyForm({ document, onChange }: StudyFormProps) {
  const { data: kinds = [] } = useQuery(experimentKindsQuery);
  const experiment = document.experiment ?? "tracking";
  const choices = useVaried(experiment);
  const set = (part: Partial<StudyDocument>) => onChange({ ...document, ...part });
  const known = kinds.some(({ name }) => name === experiment);
  return (
    <fieldset className={styles.form} aria-label="Form of the study">
      <div className={styles.row}>
        <TextInput
          label="Name"
          value={document.name ?? ""}
          onChange={(event) => set({ name: event.currentTarget.value })}
        />
        <TextInput
          label="Title"
          style={{ flex: 1 }}
          value={document.title ?? ""}
          onChange={(event) => set({ title: event.currentTarget.value })}
        />
        {document.written === undefined ? (
          <NativeSelect
            label="Experiment"
            data={[
              ...(known ? [] : [{ value: experiment, label: experiment }]),
              ...kinds.map(({ name, title }) => ({ value: name, label: title })),
            ]}
            value={experiment}
            onChange={(event) => set({ experiment: event.currentTarget.value })}
          />
        ) : (
          <span className={page.dim}>The experiment is written in the text.</span>
        )}
      </div>
      <FixedSettings
        settings={document.settings ?? {}}
        choices={choices}
        onChange={(settings) => set({ settings })}
      />
      <AxisRows axes={document.axes ?? []} choices={choices} onChange={(axes) => set({ axes })} />
      <SpreadRows spread={document.spread ?? []} choices={choices} onChange={(spread) => set({ spread })} />
      <div className={styles.row}>
        <NumberBox
          label="Plants"
          of="that are drawn"
          unit="1"
          value={document.draws ?? 1}
          onChange={(draws) => set({ draws })}
        />
        <NumberBox
          label="Seeds"
          of="of the noise"
          unit="1"
          value={document.seeds ?? 1}
          onChange={(seeds) => set({ seeds })}
        />
        <NumberBox
          label="Seed"
          of="of the draws"
          unit="1"
          value={document.seed ?? 0}
          onChange={(seed) => set({ seed })}
        />
      </div>
    </fieldset>
  );
}

interface FixedProps {
  readonly settings: Readonly<Record<string, Value>>;
  readonly choices: Choices;
  onChange(settings: Readonly<Record<string, Value>>): void;
}

/** What is the same in each run, and other than what is in force. */
function FixedSettings({ settings, choices, onChange }: FixedProps) {
  const entries = Object.entries(settings);
  const replace = (index: number, entry: [string, Value]) =>
    onChange(Object.fromEntries(entries.with(index, entry)));
  const further = [...choices.experiment, ...choices.loop].find(({ name }) => !(name in settings));
  return (
    <fieldset className={`${styles.group} ${page.fields}`}>
      <legend>Settings: the same in each run; others are as they are in force</legend>
      {entries.map(([name, value], index) => (
        <fieldset key={name} className={styles.row} aria-label={`Setting ${index + 1}`}>
          <VariedSelect
            label={`Name of setting ${index + 1}`}
            value={name}
            choices={choices}
            only={["experiment", "loop"]}
            onChange={(next) => replace(index, [next, variedOf(choices, next).value])}
          />
          <SettingBox
            of={`of setting ${index + 1}`}
            unit={variedOf(choices, name).unit}
            usual={variedOf(choices, name).value}
            value={value}
            onChange={(next) => replace(index, [name, next])}
          />
          <ActionIcon
            variant="subtle"
            color="gray"
            aria-label={`Remove setting ${index + 1}`}
            onClick={() => onChange(Object.fromEntries(entries.toSpliced(index, 1)))}
          >
            <TbX size={14} />
          </ActionIcon>
        </fieldset>
      ))}
      <div>
        <Button
          variant="default"
          size="compact-xs"
          leftSection={<TbPlus size={13} />}
          disabled={further === undefined}
          onClick={() => further && onChange({ ...settings, [further.name]: further.value })}
        >
          Add setting
        </Button>
      </div>
    </fieldset>
  );
}

interface BoxProps {
  readonly of: string;
  readonly unit: string;
  readonly usual: Value;
  readonly value: Value;
  onChange(value: Value): void;
}

function SettingBox({ of, unit, usual, value, onChange }: BoxProps) {
  if (typeof usual === "boolean" || typeof value === "boolean") {
    return (
      <NativeSelect
        aria-label={`Value ${of}`}
        data={["false", "true"]}
        value={String(value)}
        onChange={(event) => onChange(event.currentTarget.value === "true")}
      />
    );
  }
  if (typeof usual === "number") {
    return <NumberBox label="Value" of={of} unit={unit} value={value} onChange={onChange} />;
  }
  return (
    <TextInput
      label="Value"
      aria-label={`Value ${of}`}
      value={value}
      onChange={(event) => onChange(event.currentTarget.value)}
    />
  );
}
