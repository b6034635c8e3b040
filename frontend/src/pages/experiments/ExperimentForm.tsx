/** Set-up of one kind of experiment. */

import { Button } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { SettingField, type SettingValue } from "../../components/SettingField";
import { useLive } from "../../live/react";
import { duration } from "../../samples/format";
import { type SettingValues, useStartExperiment } from "../../service/commands";
import type { ExperimentKind } from "../../wire/types";
import { whyNot } from "../operate/ModeCard";
import page from "../Page.module.css";

export function ExperimentForm({
  kind,
  onStarted,
}: {
  kind: ExperimentKind;
  onStarted: (id: number) => void;
}) {
  const [changed, setChanged] = useState<SettingValues>({});
  const state = useLive((live) => live.state);
  const start = useStartExperiment();
  const reason = state?.task != null ? "Another task is running." : whyNot(state, "experiment");

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (reason !== null) return;
    const settings = Object.fromEntries(Object.entries(changed).filter(([, value]) => value !== ""));
    start.mutate({ name: kind.name, settings }, { onSuccess: (started) => onStarted(started.id) });
  }

  return (
    <Card title={kind.title} aside={<span className={page.dim}>{duration(kind.duration_s)}</span>}>
      <form className={page.fields} aria-label={kind.title} onSubmit={submit}>
        <span className={page.dim}>{kind.description}</span>
        {kind.settings.map((setting) => (
          <SettingField
            key={setting.name}
            setting={setting}
            value={changed[setting.name] ?? setting.default ?? ""}
            onChange={(value: SettingValue) => setChanged((before) => ({ ...before, [setting.name]: value }))}
          />
        ))}
        <Button
          type="submit"
          size="sm"
          aria-disabled={reason !== null}
          data-disabled={reason !== null || undefined}
          loading={start.isPending}
        >
          {`Start ${kind.title.toLowerCase()}`}
        </Button>
        <Refusal text={start.error?.message ?? reason} />
      </form>
    </Card>
  );
}
