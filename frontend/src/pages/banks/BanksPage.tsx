/** Banks of controllers: versions, entries, where each entry came from, and which one is in use. */

import { Button, Table } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { Link, useParams } from "wouter";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { SignalName } from "../../components/SignalName";
import { dateTime, fixed, significant } from "../../samples/format";
import { useActivateBank } from "../../service/commands";
import { banksQuery } from "../../service/queries";
import type { Bank } from "../../wire/types";
import page from "../Page.module.css";

export default function BanksPage() {
  const { id } = useParams();
  const banks = useQuery(banksQuery);
  const activate = useActivateBank();
  const all = banks.data ?? [];
  const selected = all.find((bank) => bank.id === Number(id)) ?? all.find((bank) => bank.active) ?? all[0];
  return (
    <div className={page.page}>
      <h1 className={page.title}>Banks</h1>
      <Card title="Banks">
        {banks.data === undefined && <p className={page.empty}>{banks.error?.message ?? "Loading …"}</p>}
        {banks.data?.length === 0 && (
          <p className={page.empty}>
            No bank yet: gains come from geometry. <Link href="/identify">Identify</Link> the actuator at some
            tensions, then build a bank from the runs.
          </p>
        )}
        {all.length > 0 && (
          <div className={page.tableScroll}>
            <Table aria-label="Banks" highlightOnHover>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>Bank</Table.Th>
                  <Table.Th>Built</Table.Th>
                  <Table.Th className={page.number}>Entries</Table.Th>
                  <Table.Th>Stiffness [N·m/rad]</Table.Th>
                  <Table.Th>Use</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {all.map((bank) => (
                  <Table.Tr key={bank.id} bg={bank.id === selected?.id ? "var(--accent-soft)" : undefined}>
                    <Table.Td>
                      <Link href={`/banks/${bank.id}`}>{`${bank.name} v${bank.version}`}</Link>
                    </Table.Td>
                    <Table.Td>{dateTime(bank.created)}</Table.Td>
                    <Table.Td className={page.number}>{bank.entries.length}</Table.Td>
                    <Table.Td>{bank.entries.map((entry) => fixed(entry.S_nominal, 2)).join(" · ")}</Table.Td>
                    <Table.Td>
                      {bank.active ? (
                        <strong>active</strong>
                      ) : (
                        <Button
                          size="compact-xs"
                          variant="default"
                          aria-label={`Activate ${bank.name} v${bank.version}`}
                          loading={activate.isPending && activate.variables === bank.id}
                          onClick={() => activate.mutate(bank.id)}
                        >
                          Activate
                        </Button>
                      )}
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </div>
        )}
      </Card>
      <Refusal text={activate.error?.message} />
      {selected && <Entries bank={selected} />}
    </div>
  );
}

function Entries({ bank }: { bank: Bank }) {
  return (
    <Card title={`Entries of ${bank.name} v${bank.version}`}>
      <div className={page.tableScroll}>
        <Table aria-label="Entries">
          <Table.Thead>
            <Table.Tr>
              <Table.Th className={page.number}>Tension [N]</Table.Th>
              <Table.Th className={page.number}>S [N·m/rad]</Table.Th>
              <Table.Th className={page.number}>
                K of <SignalName name="G_q" />
              </Table.Th>
              <Table.Th className={page.number}>
                T of <SignalName name="G_q" /> [s]
              </Table.Th>
              <Table.Th className={page.number}>
                K of <SignalName name="G_S" />
              </Table.Th>
              <Table.Th className={page.number}>
                T of <SignalName name="G_S" /> [s]
              </Table.Th>
              <Table.Th>Came from</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {bank.entries.map((entry) => (
              <Table.Tr key={entry.S_nominal}>
                <Table.Td className={page.number}>{fixed(entry.tension_N, 0)}</Table.Td>
                <Table.Td className={page.number}>{fixed(entry.S_nominal, 2)}</Table.Td>
                <Table.Td className={page.number}>{significant(entry.K_q, 4)}</Table.Td>
                <Table.Td className={page.number}>{significant(entry.T_q, 3)}</Table.Td>
                <Table.Td className={page.number}>{significant(entry.K_S, 4)}</Table.Td>
                <Table.Td className={page.number}>{significant(entry.T_S, 3)}</Table.Td>
                <Table.Td>
                  <Link href={`/identify/${entry.identification}`}>
                    Identification {entry.identification}
                  </Link>
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </div>
    </Card>
  );
}
