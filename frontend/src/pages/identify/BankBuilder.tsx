/** Makes a bank of controllers from the chosen runs. */

import { Button } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { TextField } from "../../components/TextField";
import { useBuildBank } from "../../service/commands";
import { RefusedFields } from "../../service/refusedFields";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

export function BankBuilder({ chosen, onBuilt }: { chosen: ReadonlySet<number>; onBuilt: () => void }) {
  const [name, setName] = useState("");
  const build = useBuildBank();
  const runs = [...chosen].sort((a, b) => a - b);
  const ready = runs.length > 0 && name.trim() !== "";

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (ready) build.mutate({ name: name.trim(), identifications: runs }, { onSuccess: onBuilt });
  }

  return (
    <Card title="Bank from runs" className={runs.length > 0 ? styles.builder : undefined}>
      <RefusedFields error={build.error} about={name}>
        <form className={page.fields} aria-label="Bank from runs" onSubmit={submit}>
          <span className={page.dim}>
            {runs.length === 0
              ? "Tick the runs to use in the list."
              : `Chosen: ${runs.map((run) => `run ${run}`).join(", ")}`}
          </span>
          <TextField name="name" label="Bank name" value={name} onChange={setName} />
          <Button type="submit" variant="default" disabled={!ready} loading={build.isPending}>
            Build bank
          </Button>
          {build.data && (
            <span>
              Built{" "}
              <Link href={`/banks/${build.data.id}`}>{`${build.data.name} v${build.data.version}`}</Link>.
            </span>
          )}
          <Refusal error={build.error} about={name} />
        </form>
      </RefusedFields>
    </Card>
  );
}
