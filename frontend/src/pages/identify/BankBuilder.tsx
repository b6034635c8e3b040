/** Makes a bank of controllers from the ticked runs, and activates it. */

import { Button } from "@mantine/core";
import { type FormEvent, useState } from "react";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { TextField } from "../../components/TextField";
import { useLive } from "../../live/react";
import { useActivateBank, useBuildBank } from "../../service/commands";
import { RefusedFields } from "../../service/refusedFields";
import { useNoRetuning } from "../../service/useNoControl";
import type { Bank } from "../../wire/types";
import { nameOf } from "../banks/BankTable";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

export function BankBuilder({ chosen, onBuilt }: { chosen: ReadonlySet<number>; onBuilt: () => void }) {
  const [name, setName] = useState("");
  const build = useBuildBank();
  const runs = [...chosen].sort((a, b) => a - b);
  const ready = runs.length > 0 && name.trim() !== "";
  const inSight = runs.length > 0 || build.data !== undefined;

  function submit(event: FormEvent): void {
    event.preventDefault();
    if (ready) build.mutate({ name: name.trim(), identifications: runs }, { onSuccess: onBuilt });
  }

  return (
    <Card title="Bank from runs" className={inSight ? styles.builder : undefined}>
      <RefusedFields error={build.error} about={name}>
        <form className={styles.build} aria-label="Bank from runs" onSubmit={submit}>
          <TextField name="name" label="Bank name" value={name} onChange={setName} />
          <Button type="submit" variant="default" disabled={!ready} loading={build.isPending}>
            Build bank
          </Button>
          <span className={page.dim}>
            {runs.length === 0
              ? "Tick the runs to use in the list above."
              : `Chosen: ${runs.map((run) => `run ${run}`).join(", ")}`}
          </span>
        </form>
        {build.data && <Built bank={build.data} />}
        <Refusal error={build.error} about={name} />
      </RefusedFields>
    </Card>
  );
}

/** What was built, with the step that comes next. */
function Built({ bank }: { bank: Bank }) {
  const activate = useActivateBank();
  const active = useLive((live) => live.state?.tuning.bank?.id === bank.id);
  const locked = useNoRetuning();
  const name = nameOf(bank);
  return (
    <div className={styles.built}>
      <span>
        Built <Link href={`/banks/${bank.id}`}>{name}</Link>.
      </span>
      {active ? (
        <output>It is active: the loop uses its gains.</output>
      ) : (
        <Button
          size="compact-sm"
          aria-label={`Activate ${name}`}
          disabled={locked !== null}
          loading={activate.isPending}
          onClick={() => activate.mutate(bank.id)}
        >
          Activate
        </Button>
      )}
      <Refusal error={activate.error} text={active ? null : locked} />
    </div>
  );
}
