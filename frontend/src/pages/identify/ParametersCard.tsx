/** The parameters in force by versions: who applied what, from which identification, and one step back. */

import { Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link } from "wouter";
import { Card } from "../../components/Card";
import { dateTime } from "../../samples/format";
import { parametersQuery, useUndoParameters } from "../../service/comparedModels";
import type { Parameters } from "../../wire/types";
import page from "../Page.module.css";
import { ChangeTable } from "./ApplyParameters";
import { ChangeButton } from "./ChangeButton";
import styles from "./Identify.module.css";

const DIGEST_SHOWN = 12;

type Version = Parameters["versions"][number];

export function ParametersCard() {
  const { data, error } = useQuery(parametersQuery(null));
  const undo = useUndoParameters();
  const newest = data?.versions[0];
  return (
    <Card title="Parameters in force">
      {error && <p className={page.empty}>{error.message}</p>}
      {data && newest && (
        <>
          <p className={page.lead}>
            {data.name}, {newest.number === 0 ? "as the file says" : `version ${newest.number}`},{" "}
            <code title={newest.digest}>{newest.digest.slice(0, DIGEST_SHOWN)}</code>
          </p>
          <div className={styles.scroll}>
            <Table aria-label="Versions of the parameters">
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>Version</Table.Th>
                  <Table.Th>When</Table.Th>
                  <Table.Th>Who</Table.Th>
                  <Table.Th>From</Table.Th>
                  <Table.Th>Numbers</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {data.versions.map((version) => (
                  <Table.Tr key={version.number}>
                    <Table.Td>{version.number}</Table.Td>
                    <Table.Td className={styles.together}>
                      {version.at === null ? "at the start" : dateTime(version.at)}
                    </Table.Td>
                    <Table.Td>{version.who || "nobody"}</Table.Td>
                    <Table.Td>
                      <Origin version={version} />
                    </Table.Td>
                    <Table.Td>
                      <code title={version.digest}>{version.digest.slice(0, DIGEST_SHOWN)}</code>
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </div>
          {newest.number > 0 && (
            <section className={styles.model} aria-label="Newest change">
              <h3 className={styles.heading}>What version {newest.number} changed</h3>
              <ChangeTable label="Parameters that changed" changes={newest.changes} />
              <ChangeButton
                error={undo.error}
                pending={undo.isPending}
                about={newest.number}
                onPress={() => undo.mutate(newest.number)}
              >
                {`Undo version ${newest.number}`}
              </ChangeButton>
            </section>
          )}
        </>
      )}
    </Card>
  );
}

function Origin({ version }: { version: Version }) {
  const { number, run, estimate, undone } = version;
  const from =
    run !== null ? (
      <Link href={`/identify/${run}`}>Run {run}</Link>
    ) : estimate === null ? (
      "the parameter file"
    ) : (
      "a measured table"
    );
  return undone ? <>back to {from}</> : number === 0 ? "the parameter file" : from;
}
