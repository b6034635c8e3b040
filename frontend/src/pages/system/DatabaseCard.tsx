/** Disk and database: how they do, a check of all of it, and copies. */

import { Button } from "@mantine/core";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { Verdict } from "../../components/Verdict";
import { bytes, dateTime } from "../../samples/format";
import { useBackup, useCheck } from "../../service/system";
import type { SystemState } from "../../wire/types";
import { Facts } from "./Facts";
import styles from "./System.module.css";

/** A day at the bench takes about 2 GB. */
const LITTLE_BYTES = 2e9;

export function DatabaseCard({ system }: { system: SystemState | undefined }) {
  const backup = useBackup();
  const check = useCheck();
  const database = system?.database;
  const newest = system?.backups[0];
  const free = database?.disk_free_bytes ?? 0;
  return (
    <Facts
      title="Disk and database"
      facts={[
        [
          "Database",
          database && `${database.kind}, ${bytes(database.size_bytes)}, schema ${database.schema_revision}`,
        ],
        ["Free on the disk", database && <Verdict good={free >= LITTLE_BYTES}>{bytes(free)}</Verdict>],
        [
          "Last backup",
          newest ? `${dateTime(newest.at)}, ${bytes(newest.size_bytes)}, ${newest.name}` : "none yet",
        ],
        ["Restore", "stop the service, then: sinew db restore FILE"],
      ]}
    >
      <div className={styles.actions}>
        <OperatorsOnly>
          <Button variant="default" loading={backup.isPending} onClick={() => backup.mutate()}>
            Back up now
          </Button>
          <Button variant="default" loading={check.isPending} onClick={() => check.mutate()}>
            Check the database
          </Button>
        </OperatorsOnly>
        {check.data && (
          <Verdict good={check.data.length === 0}>
            {check.data.length === 0 ? "the database is whole" : check.data.join("; ")}
          </Verdict>
        )}
        <Refusal error={backup.error ?? check.error} />
      </div>
    </Facts>
  );
}
