/** Set-up of one kind of experiment: start it, queue it, or play it on a simulator first. */

import { Button } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { Refusal } from "../../components/Refusal";
import { SettingField, type SettingValue } from "../../components/SettingField";
import { useLive } from "../../live/react";
import { type SettingValues, useDryRun, useQueueCommand, useStartExperiment } from "../../service/commands";
import type { DryRun, ExperimentKind, Setting } from "../../wire/types";
import { whyNot } from "../operate/ModeCard";
import page from "../Page.module.css";
import { SegmentsEditor } from "./SegmentsEditor";

/** Settings of the loop, the same for every kind. */
const OF_THE_LOOP = new Set(["lam_q", "lam_S", "lam_motor", "bank", "interpolate", "seed"]);

interface ExperimentFormProps {
  readonly kind: ExperimentKind;
  onStarted(id: number): void;
  onDryRun(result: DryRun): void;
}

export function ExperimentForm({ kind, onStarted, onDryRun }: ExperimentFormProps) {
  const [changed, setChanged] = useState<SettingValues>({});
  const state = useLive((live) => live.state);
  const start = useStartExperiment();
  const dryRun = useDryRun();
  const queue = useQueueCommand();
  const reason = state?.task != null ? "Another task is running." : whyNot(state, "experiment");
  const failure = start.error ?? dryRun.error ?? queue.error;
  const order = () => ({
    name: kind.name,
    settings: Object.fromEntries(Object.entries(changed).filter(([, value]) => value !== "")),
  });

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason !== null) return;
    start.mutate(order(), { onSuccess: (started) => onStarted(started.id) });
  }

  const field = (setting: Setting) => (
    <Field
      key={setting.name}
      setting={setting}
      value={changed[setting.name] ?? setting.default ?? ""}
      onChange={(value) => setChanged((before) => ({ ...before, [setting.name]: value }))}
    />
  );

  return (
    <form className={page.fields} aria-label={kind.title} onSubmit={submit}>
      <span className={page.dim}>{kind.description}</span>
      {kind.settings.filter(({ name }) => !OF_THE_LOOP.has(name)).map(field)}
      <details>
        <summary>Settings of the loop</summary>
        <div className={page.fields} style={{ paddingTop: 8 }}>
          {kind.settings.filter(({ name }) => OF_THE_LOOP.has(name)).map(field)}
        </div>
      </details>
      <div className={page.actions}>
        <Button
          type="submit"
          size="sm"
          aria-label={`Start ${kind.title.toLowerCase()}`}
          aria-disabled={reason !== null}
          data-disabled={reason !== null || undefined}
          loading={start.isPending}
        >
          Start
        </Button>
        <Button
          size="sm"
          variant="default"
          loading={queue.isPending}
          onClick={() => queue.mutate({ do: "add", ...order() })}
        >
          Add to queue
        </Button>
        <Button
          size="sm"
          variant="default"
          loading={dryRun.isPending}
          title="Play it on a simulator of its own, faster than real time; nothing moves"
          onClick={() => dryRun.mutate(order(), { onSuccess: onDryRun })}
        >
          Dry run
        </Button>
      </div>
      <Refusal text={failure?.message ?? reason} />
    </form>
  );
}

interface FieldProps {
  readonly setting: Setting;
  readonly value: SettingValue;
  onChange(value: SettingValue): void;
}

function Field({ setting, value, onChange }: FieldProps) {
  if (setting.name === "segments") return <SegmentsEditor json={String(value)} onChange={onChange} />;
  return <SettingField setting={setting} value={value} onChange={onChange} />;
}
